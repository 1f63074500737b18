"""`crease bench properties`: is the force one that a contact must have? P1 to P9, without any reference force."""
