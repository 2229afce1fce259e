"""The figures and tables of LR-743 from databases and what was flown: numbers, drawing, the set as
a folder.
"""
