"""Where actions come from: scripted experts, trained policies, recorded episodes."""
