"""Photographs that a workflow asks for: taken by devices that procam drives, or by people, in rounds.

A workflow says what shall be shown and how long exposed (`Wanted`), and a `Photographer` gives the
photograph. `driven` shows and photographs. `by_hand` writes the pictures to disk and stops the workflow; when
their photographs are stored the workflow runs again from its beginning, and finds them there.
"""
