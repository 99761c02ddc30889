"""The judge of adapters: whether a world keeps the contract of `vtables/contract.py`."""
