"""`python -m ss2sql`, the same as `ss2sql`."""

from ss2sql.cli import main

if __name__ == "__main__":
    main()
