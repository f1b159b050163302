"""An approach in operation or in a replay: advice, deviations, landing reports, and what is sent of them."""
