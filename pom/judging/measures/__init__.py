"""What is extracted from the records and compared, one module per kind; every measure takes a
criterion and a `Comparison`.
"""
