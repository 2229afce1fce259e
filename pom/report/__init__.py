"""The Proof-of-Match report: page, document, numbers for programs."""
