"""Step-by-step drives of a rig: generators that yield events. Here devices meet estimators."""
