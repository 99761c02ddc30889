"""The language itself, which all other rooms use: its operations."""
