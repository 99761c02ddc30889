"""From text to the syntax tree: `Source` in, `ast.Script` out, or a `ParseError` with a hint.

In order of control flow: tokenizer, grammar.lark, grammar_table.json with parse_table, parser, tree_builder, ast. Where
a text does not fit: parse_failure, syntax_errors, foreign_spellings.
"""
