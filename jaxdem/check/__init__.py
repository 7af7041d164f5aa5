"""What `jaxdem check` finds out about a scene without running it."""
