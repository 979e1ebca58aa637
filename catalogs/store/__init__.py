"""The Cinema database: the catalog, its plan, its members, and the table that is rebuilt from them."""
