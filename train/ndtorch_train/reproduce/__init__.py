"""Every published result again: one experiment a claim, cached, drawn and put beside what was printed."""
