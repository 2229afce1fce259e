"""The face: command line, project file and the whole job in one call; no physics and no statistics
here.
"""
