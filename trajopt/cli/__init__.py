"""The command line."""

from trajopt.cli.app import main as main
