"""Run by cinemasci's own Python: list the database in argv[1], and the files of the rows that match each query in argv[2:]."""

import json
import sys

import cinemasci

database = cinemasci.new("cdb", {"path": sys.argv[1]})
accepted = database.read_data_from_file()
names = list(database.get_parameter_names())
database.set_extract_parameter_names(["FILE"])
answers = [database.get_extracts(json.loads(query)) for query in sys.argv[2:]]
print(json.dumps({"accepted": bool(accepted), "names": names, "answers": answers}))
