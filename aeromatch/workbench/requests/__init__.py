"""What is checked of each request before the workbench answers it: host, token, length, body."""
