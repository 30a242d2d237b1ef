"""Quantities that are computed from recorded signals: filtered wrenches, contacts, views from straight above."""
