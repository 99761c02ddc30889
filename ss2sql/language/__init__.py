"""What everybody else speaks: the operations of the language."""
