"""aeromatch/project"""
