"""Documents of text, formulas, tables and pictures, written as HTML, Markdown or LaTeX."""
