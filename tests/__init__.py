"""Tests of tfdb: one folder per kind of proof, one file per room."""
