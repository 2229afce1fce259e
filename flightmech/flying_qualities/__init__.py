"""Flying qualities and performance of any database: the quantities of the Smetana program ([LR743] section 2.2), one module per subject."""
