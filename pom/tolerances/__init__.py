"""The tolerance table: rows, bands, conditions, and the channels that they are judged on."""
