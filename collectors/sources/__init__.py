"""Sources of actions: scripted experts, trained policies and recorded episodes."""
