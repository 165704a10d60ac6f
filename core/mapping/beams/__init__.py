"""Method `beams`: exact geometry for each beam, evidence in cells."""
