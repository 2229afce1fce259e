"""A fit from its TOML file to its report."""
