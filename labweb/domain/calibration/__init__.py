"""What a device's numbers are worth: calibration, correction and expanded uncertainty."""
