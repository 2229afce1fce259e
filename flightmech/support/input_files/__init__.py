"""Files of a user as bytes and text: no regular file, another encoding, too wide or too deep is an error, never a hang or a crash."""
