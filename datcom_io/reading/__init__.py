"""Reading a listing: lines, regions, headings, pages, faults."""
