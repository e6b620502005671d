"""How the regions of the model `figures` become tracks: all constants."""

from __future__ import annotations

from pydantic import Field

from ndtorch.config import Constants


class FigureParams(Constants):
    """How regions become tracks. Lengths as shares of the object's own size unless they say otherwise, times in
    seconds."""

    smallest: float = Field(0.0005, gt=0, description="smallest region, as a share of the picture")
    tiny: float = Field(0.0002, gt=0, description="smallest region of a thing far away, which is")
    alone: float = Field(0.2, ge=0, description="farther than this from all that is larger, shares of the height,")
    certain: float = Field(2.0, ge=0, description="and an object after so many times the way that others have to go,")
    unbent: float = Field(0.8, ge=0, le=1, description="if it is this straight, and clear")
    gap: int = Field(2, ge=0, description="gaps that are closed, pixels of that image")
    notch: float = Field(0.8, ge=0, le=1, description="a region is cut where it has less of its height than both sides")
    shadow: float = Field(
        0.5, gt=0, le=1, description="a track is none but a shadow where so much of it may be a narrow one"
    )
    shared: float = Field(0.3, gt=0, description="share of a region or of a track's box that makes them meet")
    piece: float = Field(0.6, gt=0, description="share of a region inside a track's box that makes it a piece of it")
    gate: float = Field(1.0, gt=0, description="how far from where a track is expected a region may be,")
    reach: float = Field(1.0, ge=0, description="and how much further a second later")
    unlike: float = Field(2.0, ge=0, description="cost of another color (full scale), where a gate's distance costs 1")
    known_by: float = Field(4.0, ge=0, description="the same where a group parts,")
    leaves: float = Field(1.5, gt=0, description="and most that it may cost to leave the group for another region")
    familiar: float = Field(1.0, ge=0, description="of one that was in sight for this long,")
    alike_size: float = Field(3.0, gt=1, description="largest ratio of the areas of two sightings apart")
    follow: float = Field(0.6, gt=0, le=1, description="share of the difference taken into the place")
    grouped: float = Field(0.5, gt=0, le=1, description="of that share, in a region that several tracks have in common")
    own_color: float = Field(16.0, ge=0, description="where a pixel of such a region goes: square of another color,")
    blurred: int = Field(5, ge=1, description="in the mean over so many pixels, against that of its distance")
    room: float = Field(0.5, ge=0, le=1, description="a track in such a region is hidden with room for less than this")
    tau_velocity: float = Field(0.4, ge=0, description="a sighting after t changes the velocity by t / (this + t)")
    tau_size: float = Field(0.4, ge=0, description="memory of the size and of the color")
    coast: float = Field(1.0, ge=0, description="how long a track out of sight is waited for")
    ahead: float = Field(0.5, ge=0, description="for how much of that its place is taken on at its velocity")
    warm_up: float = Field(1.0, ge=0, description="nothing is called an object before; the ground is not known yet")
    shortest: float = Field(0.3, ge=0, description="smallest time in sight of an object")
    steady: float = Field(0.5, ge=0, le=1, description="and smallest share of the time since it was first seen")
    travel: float = Field(0.7, ge=0, description="smallest way gone; 0 reports what does not travel too,")
    way: float = Field(0.05, ge=0, description="otherwise it is at least this share of the picture's height,")
    wander: float = Field(3.0, ge=1, description="and so many times that where more than")
    restless: float = Field(0.5, gt=0, description="so many tracks came and went that never were objects: leaves;")
    forget: float = Field(20.0, gt=0, description="which is forgotten with this time constant,")
    glimpse: float = Field(0.08, ge=0, description="of tracks that were in sight for longer than this,")
    near: float = Field(0.5, ge=0, description="and were not nearer than this to an object, in its sizes,")
    shortly: float = Field(0.5, ge=0, description="from this long before to this long after")
    many: float = Field(
        5.0, gt=0, description="where so many tracks of a size came, a second and square of the height,"
    )
    lately: float = Field(5.0, gt=0, description="within this time, one of them is no object: snow;")
    same_size: float = Field(1.5, gt=1, description="of a size are sides of up to this ratio;")
    crowded: float = Field(18.0, gt=0, description="nor is it where so many of a size came around it,")
    among: float = Field(0.2, gt=0, description="up to so many heights away: glints on water;")
    several: int = Field(4, ge=1, description="but fewer than this are never many")
    clear: float = Field(9.0, gt=0, description="what stands out by so many deviations in the mean is a thing; else,")
    stride: float = Field(0.35, gt=0, description="after going this far, its old and its new place are looked at,")
    least_stride: float = Field(2.0, ge=0, description="and at least so many pixels of that image")
    whole: float = Field(-0.05, ge=-1, le=1, description="how much better its looks fit the new place, from -1 to 1,")
    doubt: float = Field(0.25, ge=0, description="against a doubt that a difference of this share of the light settles")
    behind: float = Field(0.3, ge=0, le=1, description="what fits its old places better by this, on a way in steps")
    step: float = Field(0.2, gt=0, description="of this share of its size that got it no further")
    straight: float = Field(0.4, ge=0, le=1, description="than this share of its length, swings: leaves")
    trial: float = Field(5.0, ge=0, description="an object is taken back within this time if it never was further from")
    swing: float = Field(0.35, ge=0, le=1, description="where it began than this share of its way's length,")
    grown: float = Field(0.5, ge=0, description="or than this: it only grew")
    larger: float = Field(2.0, ge=1, description="a track of this many times its pixels,")
    beside: float = Field(1.0, ge=0, description="nearer than this share of the other's size,")
    fate: float = Field(0.5, ge=0, description="whose velocity differs by less than this share, is what it is part of")
    moves: float = Field(0.5, ge=0, description="way gone that counts as moving on")
    rests: float = Field(1.5, ge=0, description="an object that did not move on for this long rests")
    stays: float = Field(60.0, ge=0, description="what stops stays an object for this long")
    doubtful: float = Field(1.0, ge=0, description="what never travelled is learned as ground after this long")
