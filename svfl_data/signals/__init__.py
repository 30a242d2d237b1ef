"""What is computed from recorded signals: filtered wrenches, contacts, views from straight above."""
