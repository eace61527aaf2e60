"""Faults on the wire, by name or at random: how soon the body stands, whether it goes on, and that nothing crashes."""
