"""Page of a new project: dropped files, columns, aircraft data, and the commands that change them."""
