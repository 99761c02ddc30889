"""The judge of adapters: whether a world keeps the contract of `vtables/contract.py`.

check_world asks the world, random_queries runs queries over it and over its copy.
"""
