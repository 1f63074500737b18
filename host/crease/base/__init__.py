"""What every room needs: errors, units, tables, the C code through cffi, scene images."""
