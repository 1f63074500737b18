"""The closed loop: servo, bus, drives, mechanism and hand."""
