"""From DATCOM listings to the a-priori database."""
