"""From the syntax tree to the plan: names are bound, calls checked, types and volatility computed.

In order of control flow: catalog (what exists), resolver (expressions), query_clauses (queries), from_clause,
world_references, scope, search_options, state_types, path_functions, grouping with structural_equality,
hidden_columns, suggestions.
"""
