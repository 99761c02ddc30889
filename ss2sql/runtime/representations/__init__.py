"""Representations: what `AS name` makes of rows.

A representation is a function of a `Table` and the arguments of AS. Of a search it is called once per path. Adapters of
worlds declare their own, see `World.representations`.
"""
