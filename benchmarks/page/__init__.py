"""What a page is made of: sections, tables, the style of figures."""
