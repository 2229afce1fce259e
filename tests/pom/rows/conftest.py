"""The script that flies the records is not a test; it needs ``../shared`` and JSBSim."""

collect_ignore = ["fly_rows.py"]
