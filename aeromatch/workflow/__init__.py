"""aeromatch/workflow"""
