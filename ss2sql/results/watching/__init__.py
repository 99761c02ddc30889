"""Searches that one can watch: the events of a traced run, their picture, and the page that plays them.

`runtime/search/trace.py` notes the events. search_trace is what a result keeps of them, with the clauses of the script;
animation lays them out, draws them, and fills page.html, which plays them in a browser.
"""
