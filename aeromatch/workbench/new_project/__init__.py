"""Page of a new project: dropped files, columns, aircraft data, and commands that change them."""
