"""Searches that one can watch: what a traced run hands on, its picture, and the page that plays it.

`runtime/search/watched.py` notes the events of a search. `traced.py` is what a result keeps of them, with the clauses
of the script; `scenes.py` lays them out: texts, places on a map, what became of each step; `picture.py` draws that with
matplotlib, `page.py` puts it into `page.html`, which plays it in a browser.
"""
