"""From text to the syntax tree: `Source` in, `ast.Script` out, or a `ParseError` with a hint.

In order of control flow: tokenizer, parser, tree_builder, ast. The grammar: grammar.lark, grammar_table.json,
parse_table. Where a text does not fit: parse_failure, syntax_errors, foreign_spellings.
"""
