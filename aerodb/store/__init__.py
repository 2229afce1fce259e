"""What a database is: its scheme, rules, file, history and evaluation."""
