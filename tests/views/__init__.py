"""Tests of tables, figures, reports and exports."""
