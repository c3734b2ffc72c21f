"""Views of trials: tables, statistics, figures, reports, exports."""
