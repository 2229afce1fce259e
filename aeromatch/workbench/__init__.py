"""The workbench: a project in a page of the browser, over the same objects and verbs as the command
line.

What only looks is computed by the server; what changes a file is a verb of the command line
(`actions`), runs as one
(`processes`), and is appended to a log that ``aeromatch match --actions`` replays."""
