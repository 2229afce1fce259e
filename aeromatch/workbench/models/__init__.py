"""Models in the identification: selection of terms, output error, comparison on other records."""
