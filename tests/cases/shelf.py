"""A small world for cases: books on a shelf."""

from __future__ import annotations

from ss2sql.vtables import Column, Gone, Table, TableFunction, World, function

BOOKS = {1: ("Emma", 0.0, 0.3), 2: ("Ulysses", 0.1, 1.1), 3: ("Faust", 0.2, 0.2), 4: ("Middlemarch", 0.3, 1.2)}


class Books(Table):
    name, key = "books", "id"
    columns = (
        Column("id", int, filter="=", text="the number"),
        Column("title", str, text="what stands on its back"),
        Column("x", float, "m", "how far from the left", "< <= > >="),
        Column("weight", float, "kg"),
    )
    groups = {"book": "title x", "weight": "weight"}

    def keys(self, where):
        ids = BOOKS if where.equal("id") is None else [where.equal("id")]
        return [key for key in ids if key in BOOKS and where.allows("x", BOOKS[key][1])]

    def book(self, key):
        return BOOKS[key][:2]

    def weight(self, key):
        if key == 3:
            raise Gone("somebody has borrowed it")
        return BOOKS[key][2]


class Beside(TableFunction):
    name, table = "beside", "books"

    def rows(self, book, distance=0.1):
        return [key for key in BOOKS if key != book and abs(BOOKS[key][1] - BOOKS[book][1]) < distance + 0.01]


class Shelf(World):
    """Four books; the third has been borrowed."""

    tables = (Books, Beside)

    @function
    def longer(self, book, other):
        """Whether the title is longer than that of another book."""
        return len(BOOKS[book][0]) > len(BOOKS[other][0])
