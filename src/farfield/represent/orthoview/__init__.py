"""Orthoviews: depth images of a cell from canonical directions (OV 4.1)."""
