"""What the name map and the aircraft file state, checked against the file, against geometry and
against the motion.
"""
