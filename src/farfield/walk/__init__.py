"""Recorded paths gone through again over a slow link, and how good what arrives is second by second (BEN 6)."""
