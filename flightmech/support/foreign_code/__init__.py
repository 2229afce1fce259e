"""Foreign code in child processes: one runner with limits and a sandbox, for every route."""
