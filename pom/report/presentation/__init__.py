"""What page and document share: quantities, verdict texts, traces, SVG."""
