"""Pages that need nothing but themselves: the document, and the report on a design or a recording."""
