"""What `crease bench` runs. One module for each name, with run(setup) -> Result."""
