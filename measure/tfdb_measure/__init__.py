"""Everything that measures tfdb: ``tfdb bench``, and ``make measure``, which remakes pages of docs.

Nothing here is part of the library's interface, and no wheel holds it. A *point* is one engine
under one set of parameters; a *sweep* is a list of points that differ in one parameter; a *row* is
one operation of several contenders. The work itself is done by the programs of `measure/`, or by
contenders in processes of their own (`measure/contenders/`), so that this Python is not measured.
"""
