"""Photographs that a workflow asks for: taken by devices that procam drives, or by people, in rounds.

A workflow says what shall be shown and how long exposed (`Wanted`), and a `Photographer` gives the
photograph. `driven` shows and photographs. `hand_photographer` writes the pictures to disk (`rounds`) and
stops the workflow; when their photographs are stored (`receive`) it runs again from its beginning, and finds
them.
"""
