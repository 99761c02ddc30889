"""Traced searches: the trace of a run, its plot, and the page that plays it.

runtime/search/watched.py records the events of a search. watching/traced.py keeps them with the clauses of the script;
watching/scenes.py gives each step its text, its place on a map and its outcome; watching/picture.py draws them with
matplotlib, watching/page.py writes them into `page.html`, which plays them in a browser.
"""
