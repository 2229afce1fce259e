"""Terms as CSV and MAT files; check cases."""
