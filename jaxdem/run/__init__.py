"""The time loop: programs, records, restart."""
