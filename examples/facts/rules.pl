% A thing stands on what is next below it.
on(Thing, Place) :- above(Thing, Place), \+ (above(Thing, Other), above(Other, Place)).

% The robot carries 25 kg, and nobody is to notice that a thing is gone.
light(Thing) :- mass(Thing, Mass), Mass =< 25, \+ isSensor(Thing).
watched(Thing) :- isSensing(_, Thing).
fetches(Robot, Thing, Place) :- isRobot(Robot), light(Thing), \+ watched(Thing), on(Thing, Place).

main :-
    forall(light(Thing), (on(Thing, Place), format("~w is light and stands on ~w~n", [Thing, Place]))),
    forall(fetches(Robot, Thing, Place), format("~w fetches ~w from ~w~n", [Robot, Thing, Place])).
