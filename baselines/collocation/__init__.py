"""Transcriptions on a grid."""
