"""The data package: everything a customer gets of a project in one folder or zip, with check cases,
and its verification and comparison.
"""
