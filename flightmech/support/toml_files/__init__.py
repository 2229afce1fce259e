"""TOML files of a user: their content, and the quantities in them; without pydantic, whose import takes longer than the reading."""
