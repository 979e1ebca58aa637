"""Studies, benchmarks and measured records: they import the product, and the product never imports them."""
