"""Compiled inner loops: flat arrays in and out, one algorithm a file, each with a plain twin in the tests."""
