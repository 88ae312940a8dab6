"""The answer to a run as a value: result, findings, and the document that result.json is."""
