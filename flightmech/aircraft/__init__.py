"""The aircraft: its data, its file, exchange of parts, similar aircraft."""
