"""What stands behind ``tfdb bench``: points, sweeps, the drivers in C++, results and the report.

Nothing here is part of the library's interface. A *point* is one engine under one set of
parameters; a *sweep* is a list of points that differ in one parameter. The work itself is done by
`tfdb_driver` and `tfdb_driver_tf2` (folder `driver/`), so that Python is not what is measured.
"""
