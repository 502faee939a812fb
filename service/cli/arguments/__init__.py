"""The arguments of each command, by name: what they do is imported only when it is to be done."""
