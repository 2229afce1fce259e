"""aeromatch/cli"""
