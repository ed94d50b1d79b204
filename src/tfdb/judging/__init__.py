"""Facts and findings about recordings and live stores: rates, gaps, delays, faults."""
