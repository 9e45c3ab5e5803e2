"""Save records and load them: one .npz file, arrays and a JSON header. Never a pickle; nothing in a file is executed.

The entry `header` is a JSON text:

- `format`: the version of this layout, `FORMAT` in `header.py`. `load` reads the formats that it knows and refuses others.
- `estimable`: the version of the package that wrote the file.
- `modules`: {class: module} of each record in the file, such as {"Kalman": "filters.kalman_filter"}.
- `thing`: what was saved. A number, string, bool or null is itself, a list is a list, and everything else is an object with one
  key: {"record": {"class", "fields"}}, {"array": entry}, {"scalar": entry} (of NumPy), {"float": "nan"}, {"tuple": [..]},
  {"dict": [[key, value], ..]}, {"online": record} (a run, which resumes from its `progress`).

The other entries are the arrays, named after their fields: numpy.load(path)["thing.info.mean"].

A class is looked up by name among the records of the package after its module is imported, which must be a module of the
package. After a release, two tables in `header.py` ensure that older files can be read: `MOVED`, the new place or name of a
record, and `ADDED`, the values of fields that were added later. A test loads a file that an earlier version wrote.
"""
