"""From text to plan: grammar.lark and parser.py make the syntax tree of ast.py, catalog.py says what exists,
purity.py judges functions, resolve.py turns the tree into `ss2sql.plan.Program`."""
