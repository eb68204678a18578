"""The `procam` command: `main` holds the list of commands, and each command is a module of its name.

Modules that start with an underscore are shared: options, output, checks of files, sessions. What a
command needs is imported when it runs, so the list of commands appears at once.
"""
