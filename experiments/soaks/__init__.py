"""Attacks on the toolkit, by the thousand: each module asks whether one promise can be broken.

Reading order: `tricks` (motions that claim too little), `runner` (what every attack reports). The
attacks that are texts stand in `data`.
"""
