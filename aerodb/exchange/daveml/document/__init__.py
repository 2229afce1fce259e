"""The file itself: read, evaluated and checked."""
