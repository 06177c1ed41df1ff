"""Commands beside the diagnosis: record, import, calibrate load cells, step a repaired model."""
