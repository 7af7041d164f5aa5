"""One script per question, each printing a table and writing it to results/; and the cases they share."""
