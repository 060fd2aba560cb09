"""The live page of ``algdiff designer``, served on this machine."""
