"""Commands on whole catalogs: check, repair, merge, split, pack and show."""
