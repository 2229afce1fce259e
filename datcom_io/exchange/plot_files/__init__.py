"""Plot files of DATCOM: units 13 and 14."""
